"""How far a member's word goes: what one alone may not bring about, and whose words count for separation alone."""
