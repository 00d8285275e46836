"""Ways over all that was seen (`path_search`) and known (`known_places`), and the `detour` that a vehicle is led by."""
