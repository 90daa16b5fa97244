"""The operator's page in a browser, its server and its map tiles."""
