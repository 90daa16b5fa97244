"""Mesh sessions, members with certificates, and networks that lose packets."""
