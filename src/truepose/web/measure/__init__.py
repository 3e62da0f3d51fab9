"""What is measured: plans, readings and their preview."""
