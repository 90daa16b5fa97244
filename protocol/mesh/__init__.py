"""The mesh: Zenoh sessions of drones and stations, bridged to asyncio."""
