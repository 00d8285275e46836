"""Limits of a member's word: what one alone may not bring about, and whose words count for separation alone."""
