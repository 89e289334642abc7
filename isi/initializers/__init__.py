"""Initializers of novel entities: a module here registers one under the name that ``params.yaml`` lists it by."""
