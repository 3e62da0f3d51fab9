"""The cells of the workspace: their files as text and as values."""
