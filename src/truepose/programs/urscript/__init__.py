"""URScript."""
