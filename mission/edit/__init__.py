"""`mission edit`: a page to plan a mission by clicking; each change is checked as `mission check` does."""
