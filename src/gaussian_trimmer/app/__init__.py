"""The app in the browser: the state in plain Python, and a thin layer that shows it with viser."""
