#pragma once
#include "sdk.h"
