"""The scene without the object: nothing of its inside stays, and what it stood on or leaned against goes on."""
