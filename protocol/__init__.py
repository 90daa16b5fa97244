"""Messages, keys and signatures on the links between radron processes, and the mesh below them."""
