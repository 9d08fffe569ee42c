"""The scene without an object: its hidden interior goes, and what it stood on or leaned against is inpainted."""
