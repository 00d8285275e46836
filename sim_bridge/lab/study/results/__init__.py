"""What the flights of a study show together: figures, limits, summary, plots and page."""
