"""Users in the browser: log-in, sessions, and what each role may do. The store is imported when one is opened."""
