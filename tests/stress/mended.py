"""Seeds of cases that failed and were mended: every run of their family tries them first."""

from __future__ import annotations

# family -> seeds
MENDED: dict[str, tuple[int, ...]] = {
    "drift": (70003, 310000),
    "meshed": (5005, 760079, 760146, 770001, 795248, 36126001),
    "press": (47, 2007, 40007, 40040, 40044, 70033, 110067, 510149, 760059, 760073),
    "rate": (1, 35112906),
    "card": (1004,),
    "dragged": (35112939,),
    "inside": (16,),
    "again": (15,),
    "surface": (25, 193, 223, 273, 480, 111588),
    "stretched": (1049,),
    "turned": (710053,),
    "pins": (13649,),
    "thimble": (13698, 14997, 15036, 15243, 41448, 47863, 52968, 54682, 57493, 66816),
}
