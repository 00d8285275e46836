"""The graph G of a recorded flight: is the swarm one, and how well is it connected."""

from __future__ import annotations

import numpy as np

from sim_bridge.judge.metrics.arrays import Bools, Floats
from sim_bridge.judge.metrics.pairs import Pairs
from sim_bridge.judge.recording import Recording


def connectivity(recording: Recording, pairs: Pairs, wanted: Bools) -> tuple[Bools, Floats]:
    """(T,) all alive vehicles are one component; (T,) lambda2, nan where not `wanted` (T,) or below two alive."""
    ticks, n = recording.agent_alive.shape
    connected = np.zeros(ticks, dtype=np.bool_)
    lambda2 = np.full(ticks, np.nan)
    if ticks == 0:
        return connected, lambda2
    # Links change far less often than ticks pass: each graph is worked out once
    bits = np.packbits(np.hstack((recording.agent_alive, pairs.links)), axis=1)
    _, examples, graph = np.unique(bits, axis=0, return_index=True, return_inverse=True)
    graph = graph.ravel()
    graph_wanted = np.bincount(graph, weights=wanted) > 0
    adjacency = np.zeros((n, n), dtype=np.bool_)
    graph_connected = np.zeros(len(examples), dtype=np.bool_)
    graph_lambda2 = np.full(len(examples), np.nan)
    for g, tick in enumerate(examples):
        adjacency[pairs.first, pairs.second] = adjacency[pairs.second, pairs.first] = pairs.links[tick]
        alive = np.flatnonzero(recording.agent_alive[tick])
        among_alive = adjacency[np.ix_(alive, alive)]
        graph_connected[g] = _is_connected(among_alive)
        if graph_wanted[g] and len(alive) > 1:
            laplacian = np.diag(among_alive.sum(axis=1)) - among_alive.astype(np.float64)
            graph_lambda2[g] = max(0.0, np.linalg.eigvalsh(laplacian)[1]) if graph_connected[g] else 0.0
    return graph_connected[graph], np.where(wanted, graph_lambda2[graph], np.nan)


def _is_connected(adjacency: Bools) -> bool:
    """Whether a graph (n, n) is one component; without vertices it is none."""
    reached = np.zeros(len(adjacency), dtype=np.bool_)
    newly = reached.copy()
    newly[:1] = True
    while newly.any():
        reached |= newly
        newly = adjacency[newly].any(axis=0) & ~reached
    return bool(reached.size and reached.all())
