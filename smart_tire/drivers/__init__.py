"""Serial ports, device protocols over them and clocks: bytes to samples on the host clock."""
