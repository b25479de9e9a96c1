"""Gesta: learns actions from demonstrations, recognises them online, re-enacts them."""
