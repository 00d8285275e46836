"""What was flown: recorded, measured, judged and drawn."""
