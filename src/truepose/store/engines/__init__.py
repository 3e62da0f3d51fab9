"""What differs between database engines, one module for each; the only places with SQL of one engine."""
