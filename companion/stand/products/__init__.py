"""A stand's products: files that other software opens, and a report of one page. `write_products` writes them all."""
