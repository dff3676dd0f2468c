"""The bus over Zenoh: sessions, endpoints, certificates."""
