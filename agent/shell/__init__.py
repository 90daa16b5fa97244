"""The process around the pilot: event loop, watchdog, state over a restart, logs, the service manager."""
