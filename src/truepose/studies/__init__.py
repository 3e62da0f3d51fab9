"""Complete experiments: the demonstration, the paper's experiment, and ISO 9283."""
