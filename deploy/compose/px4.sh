#!/bin/sh
# Start of a PX4 container: its image sends all MAVLink to one host; here each vehicle has its agent and a ground station.
#
# INSTANCE: number of the vehicle (MAVLink system id less one). AGENT, GROUND_STATION: their addresses.
set -eu

links=/opt/px4/etc/init.d-posix/px4-rc.mavlink
sed -i -E \
    -e "s/^(mavlink start -x) (-u \\\$udp_gcs_port_local)/\1 -t $GROUND_STATION \2/" \
    -e "s/^(mavlink start -x) (-u \\\$udp_offboard_port_local)/\1 -t $AGENT \2/" \
    -e "s/^udp_offboard_port_remote=.*/udp_offboard_port_remote=14540/" \
    -e "/udp_offboard_port_remote=14549/d" \
    "$links"
if ! grep -q -- "-t $AGENT" "$links" || ! grep -q -- "-t $GROUND_STATION" "$links"; then
    echo "px4.sh: $links of this image is not as expected: its links cannot be set" >&2
    exit 2
fi

exec /opt/px4/bin/px4 -d -i "$INSTANCE"
