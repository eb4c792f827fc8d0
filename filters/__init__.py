"""Pure mathematics: no I/O, no clock. Metres, radians, seconds; station ENU unless said otherwise."""
