"""What we do: everything that touches the world, from cameras and recordings to the command line."""
