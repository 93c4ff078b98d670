"""The stage ``closed_loop``: a plant under a law, flown once, or case by case for a campaign."""
