"""Files to one tree of elements, whatever release, spelling or tool they come from."""
