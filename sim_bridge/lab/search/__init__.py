"""Search for what nobody thinks of: random missions with random faults, judged on ground truth, shrunk where bad."""
