"""Colours of the reward machine's states: Okabe and Ito's, which colour-blind readers tell apart."""

STATE_COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#999999")
