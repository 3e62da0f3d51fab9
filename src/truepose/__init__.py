"""truepose."""
