"""Everything that is found about a mission's document: problems, what the simulator lacks, notes for a pilot."""
