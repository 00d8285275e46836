"""The program `mission`: check, schema, forest, plan."""
