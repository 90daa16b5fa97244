"""A station's picture of the swarm, without I/O: messages in, frames for the page out."""
