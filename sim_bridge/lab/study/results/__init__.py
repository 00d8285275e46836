"""Results of a study: figures, limits, summary, plots and page."""
