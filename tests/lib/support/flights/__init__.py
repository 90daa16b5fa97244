"""Pilots, navigators and swarms in simulated time, with messages, entries and recorded flights made by hand."""
