"""Maps on disk that lie under vehicles: MBTiles, or an image with its world file. No network is asked."""
