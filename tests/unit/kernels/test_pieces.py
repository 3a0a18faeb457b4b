"""What the compiled displacement of pieces of skin refuses; `test_compiled.py` has its bytes."""

from __future__ import annotations

from core.kernels import library, records
from tests.kernel_cases.case import opened
from tests.kernel_cases.pads import drawn_pieces


def test_damaged_records_are_refused() -> None:
    own = opened(library.kernels().path)
    for field in ("field", "source"):
        assert drawn_pieces(1).call(own, **{field: 0}) == [records.BAD_RECORD]
