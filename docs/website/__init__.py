"""The documentation as a site of static files, with a swarm that flies in the page: `make site`."""
