"""The search for a way over all that was seen (`path_search`), and the detour that it leads by (`detour`)."""
