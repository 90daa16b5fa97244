"""The vehicle that carries an agent."""
