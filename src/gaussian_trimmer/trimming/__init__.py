"""The steps of a trim, each of which calls what it needs of the three stages; `pipeline` puts them in order."""
