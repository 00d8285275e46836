"""Missions from and to QGroundControl's .plan files."""
