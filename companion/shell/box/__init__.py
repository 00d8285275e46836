"""The black box of a real flight: where it is kept (`opening`), and its thread (`threaded_chunks`)."""
