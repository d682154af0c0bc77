"""What a graph network has to beat at selection: rules, hand-made features and mechanics, told as much as it is."""
