"""The page's flight without a page: `python -m website.native`, to compare traces."""
