"""Tables for mode switches (MODEL 5): what runs between the last cycle of one mode and the first of the next."""
