"""The app in the browser: the state in plain Python, a plain server, and a page that draws and marks by itself."""
