"""Make this a package, so that it shadows an installed package of the same name."""
