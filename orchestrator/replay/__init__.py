"""What a recording says when it is run again, heard again, or compared."""
