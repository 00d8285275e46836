"""The page's flight without a page: `python -m docs.website.native`, to compare traces."""
