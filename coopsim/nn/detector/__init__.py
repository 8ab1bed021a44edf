"""The network of one agent: pillars, encoder, and heads that find boxes."""
