"""Real agents as processes: started, watched, and always ended."""
