"""What may fly in place of ours: another law of movement, or no safety filter. `law` loads one, `view` is what it gets,
`stages` puts it into an agent's tick."""
