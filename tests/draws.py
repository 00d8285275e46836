"""Tests over any input: `from draws import given, settings, st`, and then as with hypothesis.

Drawn plainly (tests/strategies.py), three times as many as hypothesis would. `UNDERSTORY_HYPOTHESIS=1 pytest ...` hands
the same tests to hypothesis, which learns from what it draws and shrinks what fails: do so when one does.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable
from typing import Any

if os.environ.get("UNDERSTORY_HYPOTHESIS"):
    from hypothesis import given, settings
    from hypothesis import settings as _settings
    from hypothesis import strategies as st

    _settings.register_profile("understory", derandomize=True, deadline=None)
    _settings.load_profile("understory")
else:
    import strategies as st

    EXAMPLES = 300
    SHOWN = 2_000

    class settings:  # noqa: N801 - hypothesis' name
        """`max_examples`, where it is not EXAMPLES."""

        def __init__(self, parent: settings | None = None, *, max_examples: int | None = None, **_: Any) -> None:
            self.max_examples = max_examples or (parent.max_examples if parent else EXAMPLES)

        def __call__(self, test: Any) -> Any:
            test.max_examples = self.max_examples
            return test

    def given(*strategies: st.Strategy, **named: st.Strategy) -> Callable[[Any], Any]:
        """Positional ones are for the last parameters of the test; pytest gives it the others."""

        def decorate(test: Any) -> Any:
            signature = inspect.signature(test)
            parameters = list(signature.parameters)
            drawn = named | dict(zip(parameters[len(parameters) - len(strategies) :], strategies, strict=True))

            def run(*arguments: Any, **fixtures: Any) -> None:
                for k in range(getattr(run, "max_examples", EXAMPLES)):
                    source = st.Source(f"{test.__qualname__} {k}")
                    example = {name: strategy.example(source) for name, strategy in drawn.items()}
                    try:
                        test(*arguments, **fixtures, **example)
                    except BaseException as error:
                        error.add_note(f"example {k}: {example!r}"[:SHOWN])
                        raise

            left = [p for name, p in signature.parameters.items() if name not in drawn]
            run.__dict__.update(test.__dict__)
            for name in ("__name__", "__qualname__", "__doc__", "__module__"):
                setattr(run, name, getattr(test, name))
            run.__signature__ = signature.replace(parameters=left)  # type: ignore[attr-defined]
            return run

        return decorate


__all__ = ["given", "settings", "st"]
