"""Changes that tests must notice: pieces of defences taken out, and mutants; each in a copy of the tree."""
