"""Mission and drone files, checked on load."""
