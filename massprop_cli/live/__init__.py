"""The estimate while records arrive: each is read, kept and estimated from before the next is waited for."""
