"""Files in and out: whole writing, archives, delimited text, strict numbers, units."""
