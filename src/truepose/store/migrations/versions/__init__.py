"""One module for each version of the schema; a module that was released is never changed."""
