"""``python -m radron.station``."""

from radron.station.cli import main

main()
