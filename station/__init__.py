"""The operator's side; knows only the protocol. Nothing is here yet."""
