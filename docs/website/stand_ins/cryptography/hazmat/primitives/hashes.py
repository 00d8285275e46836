"""As in `cryptography`."""

from cryptography import Absent

SHA256 = Absent
