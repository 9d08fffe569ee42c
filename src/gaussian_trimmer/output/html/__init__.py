"""Pages that open in a browser without a server: the report of a trim."""
