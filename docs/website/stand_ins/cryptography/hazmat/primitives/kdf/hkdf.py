"""As in `cryptography`."""

from cryptography import Absent

HKDF = Absent
