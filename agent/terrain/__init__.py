"""The ground on which the source lies."""
