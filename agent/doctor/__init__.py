"""What a technician asks of a drone on the bench: the preflight check, and the computer and its links besides."""
