"""Robot programs that were uploaded, and the commands that check and correct them."""
