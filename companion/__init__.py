import mission as mission  # settles, before the first module of this package, whether it comes compiled
