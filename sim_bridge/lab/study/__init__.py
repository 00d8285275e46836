"""Many flights: a study crosses parameters and seeds over missions, laws and backends."""
