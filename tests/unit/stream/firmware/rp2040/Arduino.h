/* What chip_rp2040.h takes of the Arduino core and of the Pico SDK 2.2: declarations alone, to compile against. */
#pragma once
#include "../usb_serial.h"
typedef unsigned int uint;
