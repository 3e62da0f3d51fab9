"""The arm of a cell: its shapes from the chain, and its poses."""
