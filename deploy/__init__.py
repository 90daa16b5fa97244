"""Deployment to the drones: certificates, the fleet file, disk images, updates and installation."""
