"""Do policies treat left and right alike?"""
