"""What is in a page, read without a browser."""

import base64
import hashlib
from html.parser import HTMLParser


class Page(HTMLParser):
    """Elements of a page in order, with their attributes and the text in them."""

    def __init__(self, page):
        super().__init__()
        self.elements, self.source = [], page
        self._inside = []
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.elements.append([tag, dict(attributes), ""])
        self._inside.append(self.elements[-1])

    def handle_endtag(self, tag):
        while self._inside and self._inside.pop()[0] != tag:
            pass

    def handle_data(self, data):
        for element in self._inside:
            element[2] += data

    def all(self, tag, **attributes):
        """(attributes, text) of elements of a kind with some attributes."""
        return [
            (found, text)
            for name, found, text in self.elements
            if name == tag and all(found.get(key) == value for key, value in attributes.items())
        ]

    def text_of(self, name):
        """The text in the element with an id."""
        return next(text for _, attributes, text in self.elements if attributes.get("id") == name)


def check_stands_alone(page):
    """Nothing in the page is loaded from elsewhere, and no script runs but the one that its policy names."""
    assert "http:" not in page.source and "https:" not in page.source
    for tag, attributes, _ in page.elements:
        assert not [name for name in attributes if name.startswith("on")], (tag, attributes)
        for name in ("src", "href", "srcset", "action", "data", "poster"):
            assert name not in attributes or attributes[name].startswith(("data:", "#")), (tag, attributes[name][:80])
        assert tag not in ("iframe", "object", "embed", "base", "form"), tag
    scripts = [text for attributes, text in page.all("script") if "type" not in attributes]
    assert len(scripts) == 1
    (policy, _), *more = page.all("meta", **{"http-equiv": "Content-Security-Policy"})
    checksum = base64.b64encode(hashlib.sha256(scripts[0].encode()).digest()).decode()
    assert not more
    assert f"script-src 'sha256-{checksum}'" in policy["content"]
    assert policy["content"].startswith("default-src 'none'; ")
