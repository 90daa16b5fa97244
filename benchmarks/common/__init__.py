"""Parts that several benchmarks share: swarms and flights of their own, models of soil, goals and their table."""
