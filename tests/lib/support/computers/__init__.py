"""Onboard computers without hardware: their files, disks, SSH and time servers, and virtual machines."""
