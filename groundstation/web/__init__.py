"""Live view of a vehicle in a browser: page, WebSocket server and its data."""
