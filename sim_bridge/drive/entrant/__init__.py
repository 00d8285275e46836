"""Entrants that fly in place of ours: another law, or no safety filter. `installed` finds
those of packages, `law` loads one, `view` is what it gets,
`stages` puts it into an agent's tick."""
