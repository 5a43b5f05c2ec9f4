"""Colours of the reward machine's states, by Okabe and Ito: safe for colour-blind readers."""

STATE_COLORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#999999")
