"""Checksums of `fastcrc`, which is no Python for a browser: the one that frames of MAVLink have."""

from fastcrc import crc16 as crc16
