"""What crosses a link between radron processes, and nothing else."""
