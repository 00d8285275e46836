"""A leader rises above the crowns to deliver records: `reasons` the table, `rise` the stage, `beside` for others."""
