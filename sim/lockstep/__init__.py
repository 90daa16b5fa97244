"""The swarm in one process, faster than real time: full agents in a simulated world, repeatable from a seed."""
