"""A capture device of OpenCV that the test scripts."""


class ScriptedCapture:
    def __init__(self, images: list) -> None:
        self.images = images
        self.released = False
        self.values: dict = {}
        self.refused: set = set()

    def get(self, name):
        return self.values.get(name, 0.0)

    def set(self, name, value):
        accepted = not {name, (name, value)} & self.refused
        if accepted:
            self.values[name] = value
        return accepted

    def read(self):
        return (True, self.images.pop(0)) if self.images else (False, None)

    def grab(self):
        self.taken = self.read()
        return self.taken[0]

    def retrieve(self):
        return self.taken

    def release(self) -> None:
        self.released = True
