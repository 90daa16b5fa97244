"""What must hold in every flight, whatever breaks: judged from the truth at each tick."""
