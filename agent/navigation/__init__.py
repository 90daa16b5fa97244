"""Navigation of one drone: guidance by stage, search, neighbours; fence, ground and home in its own local frame."""
