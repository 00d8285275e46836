"""Form height of a stand where nobody gives its own: volume over basal area."""

import math
from typing import Final

FORM_HEIGHT_M: Final = 40.0 / math.pi  # Denzin's rule, d2/1000 m3 of a trunk of d cm: 25 m high, form factor 0.51
