"""AMALTHEA metamodels (.ecore): which classes have which features, and a small model for each of them.

`additions` yields models that differ from a base model by one element or attribute, made from the metamodel alone.
"""

import copy
from functools import cache

from lxml import etree

XSI = "{http://www.w3.org/2001/XMLSchema-instance}type"
ID = "{http://www.omg.org/XMI}id"


class Metamodel:
    """The classes of one release."""

    def __init__(self, path):
        root = etree.parse(path).getroot()
        self.classes = {c.get("name"): c for c in root.iter("eClassifiers")}

    @cache  # noqa: B019 - one per release
    def features(self, name):
        found = {}
        for parent in (self.classes[name].get("eSuperTypes") or "").replace("#//", "").split():
            found |= self.features(parent)
        return found | {f.get("name"): f for f in self.classes[name].findall("eStructuralFeatures")}

    @cache  # noqa: B019
    def ancestors(self, name):
        parents = (self.classes[name].get("eSuperTypes") or "").replace("#//", "").split()
        return {name}.union(*(self.ancestors(parent) for parent in parents if parent in self.classes))

    @cache  # noqa: B019
    def concrete_classes(self):
        """The classes of which there may be elements, in the order of the file."""
        return {
            kind: None
            for kind, found in self.classes.items()
            if found.get(XSI) == "ecore:EClass" and "true" not in (found.get("abstract"), found.get("interface"))
        }.keys()

    @cache  # noqa: B019
    def concrete(self, name):
        """The classes of which an element may be where a class is asked for."""
        return [kind for kind in self.concrete_classes() if name in self.ancestors(kind)]

    def target(self, feature):
        return (feature.get("eType") or "").rpartition("//")[2]

    def literals(self, feature):
        found = self.classes.get(self.target(feature))
        literals = [] if found is None else found.findall("eLiterals")
        return [literal.get("literal") or literal.get("name") for literal in literals]

    def violations(self, element, name, ids):
        features = self.features(name)
        plain = {key: value for key, value in element.attrib.items() if not key.startswith("{")}
        for key, value in plain.items():
            feature = features.get(key)
            if feature is None or feature.get("containment") == "true":
                yield f"{name} has no attribute {key}"
            elif feature.get(XSI) == "ecore:EReference":
                yield from self._references(name, key, value, feature, ids)
            else:
                yield from self._literal(name, key, value, feature)
        for child in element:
            feature = features.get(child.tag)
            if feature is None or feature.get("containment") != "true":
                yield f"{name} has no element {child.tag}"
                continue
            kind = self.kind(child, feature)
            if self.target(feature) not in self.ancestors(kind) or self.classes[kind].get("abstract") == "true":
                yield f"{name}.{child.tag} cannot be a {kind}"
                continue
            yield from self.violations(child, kind, ids)
        for key, feature in features.items():
            count = len(element.findall(key))
            if feature.get("upperBound") != "-1" and count > 1:
                yield f"{name} has {count} {key}"
            if feature.get("lowerBound") == "1" and not count and key not in plain and feature.get("derived") != "true":
                yield f"{name} lacks {key}"

    def kind(self, child, feature):
        stated = child.get(XSI)
        return stated.removeprefix("am:") if stated else self.target(feature)

    def _references(self, name, key, value, feature, ids):
        tokens = value.split(" ")
        if feature.get("upperBound") != "-1" and len(tokens) > 1:
            yield f"{name}.{key} refers to several"
        for token in tokens:
            kind = ids.get(token)
            if kind is None or self.target(feature) not in self.ancestors(kind):
                yield f"{name}.{key} refers to {token}, which is {kind}"

    def _literal(self, name, key, value, feature):
        literals = self.literals(feature)
        if literals and value not in literals:
            yield f"{name}.{key} is {value}"


VALUES = {
    "EString": ["other"],
    "EBoolean": ["true"],
    "Address": ["16"],
    "EDouble": ["3.0"],
    "EFloat": ["3.0"],
    "EDoubleObject": ["3.0"],
    "NonNegativeDouble": ["3.0"],
    "PositiveDouble": ["3.0"],
}
_SKIPPED = ("name", "key")
_FILLED = ("items", "entries", "statistic", "value", "default")
_DEEPEST = 4


class Additions:
    """What may be added to a base model of one release."""

    def __init__(self, metamodel, base):
        self.metamodel = metamodel
        self.base = etree.fromstring(base)
        self.kinds = {self.base: "Amalthea"}
        self.ids = {}
        for element in self.base.iter("{*}*"):
            for child in element:
                feature = metamodel.features(self.kinds[element])[child.tag]
                self.kinds[child] = metamodel.kind(child, feature)
            if element.get("name"):
                self.ids.setdefault(self.kinds[element], []).append(f"{element.get('name')}?type={self.kinds[element]}")

    def _candidates(self, target):
        return [id for kind, ids in self.ids.items() if target in self.metamodel.ancestors(kind) for id in ids]

    def instance(self, tag, kind, target, depth=0):
        """An element of a class, with what it must have."""
        element = etree.Element(tag)
        if kind != target:
            element.set(XSI, f"am:{kind}")
        for name, feature in self.metamodel.features(kind).items():
            if name == "name":
                element.set("name", f"new_{kind}")
            if name == "value" and kind == "Time":
                element.attrib.update({"value": "3", "unit": "ms"})
            if name == "prescaler":
                element.set(name, "3")
            if name == "value" and kind in ("ModeValueCondition", "ModeValue"):
                element.set(name, "fast")
                continue
            if kind.endswith("Statistic") and name in ("value", "max"):
                element.set(name, "3")
            is_filled = name in _FILLED and feature.get("containment") == "true" and depth < 2
            if (feature.get("lowerBound") != "1" and not is_filled) or feature.get("derived") == "true":
                continue
            if feature.get("containment") == "true":
                if depth < _DEEPEST:
                    inner = self._plain(self.metamodel.target(feature))
                    element.append(self.instance(name, inner, self.metamodel.target(feature), depth + 1))
            elif feature.get(XSI) == "ecore:EReference":
                element.set(name, next(iter(self._candidates(self.metamodel.target(feature))), "none"))
            else:
                element.set(name, self._values(feature)[0])
        return element

    def _plain(self, target):
        found = self.metamodel.concrete(target)
        return "Ticks" if "Ticks" in found else found[0]

    def _values(self, feature):
        literals = [value for value in self.metamodel.literals(feature) if not value.startswith("_undef")]
        return literals or VALUES.get(self.metamodel.target(feature), ["3"])

    def elements(self):
        """Yield (owner classes, feature, class, model) for every class that an element of the base may hold.

        The owner is named by its class and by its tag.
        """
        done = set()
        for element, owner in self.kinds.items():
            for name, feature in self.metamodel.features(owner).items():
                if feature.get("containment") != "true" or feature.get("derived") == "true":
                    continue
                target = self.metamodel.target(feature)
                for kind in self.metamodel.concrete(target):
                    if (owner, name, kind) in done:
                        continue
                    done.add((owner, name, kind))
                    new = self.instance(name, kind, target)
                    yield (owner, element.tag), name, kind, self._with(element, feature, new)

    def inner(self):
        """Yield the same for the classes that no element of the base can hold: each within new elements."""
        reached = set(self.kinds.values())
        queue = []  # an element of the base, its feature, and the new elements from there on: tag, class, target
        for element, owner in self.kinds.items():
            for name, target, kind in self._below(owner, reached):
                queue.append((element, self.metamodel.features(owner)[name], [(name, kind, target)]))
        for element, feature, path in queue:
            owners = [word for name, kind, _ in reversed(path) for word in (kind, name)]
            for name, target, kind in self._below(owners[0], reached):
                longer = [*path, (name, kind, target)]
                queue.append((element, feature, longer))
                yield (*owners, self.kinds[element]), name, kind, self._with(element, feature, self._nested(longer))

    def _below(self, owner, reached):
        """Yield feature, its class and a class that an element may hold, for each class that was not reached before."""
        for name, feature in self.metamodel.features(owner).items():
            if feature.get("containment") == "true" and feature.get("derived") != "true":
                target = self.metamodel.target(feature)
                for kind in self.metamodel.concrete(target):
                    if kind not in reached:
                        reached.add(kind)
                        yield name, target, kind

    def _nested(self, path):
        root = last = self.instance(*path[0])
        for (name, kind, target), (_, owner, _) in zip(path[1:], path, strict=False):
            if self.metamodel.features(owner)[name].get("upperBound") != "-1":
                for old in last.findall(name):
                    last.remove(old)
            last.append(self.instance(name, kind, target))
            last = last[-1]
        return root

    def attributes(self):
        """Yield (owner class, attribute, value, model) for every attribute and reference of an element of the base."""
        done = set()
        for element, owner in self.kinds.items():
            for name, feature in self.metamodel.features(owner).items():
                if name in _SKIPPED or feature.get("containment") == "true" or feature.get("derived") == "true":
                    continue
                is_reference = feature.get(XSI) == "ecore:EReference"
                found = self._candidates(self.metamodel.target(feature)) if is_reference else self._values(feature)
                for value in found[:8] if is_reference else found:
                    if (owner, name, value) in done or element.get(name) == value:
                        continue
                    done.add((owner, name, value))
                    changed = copy.deepcopy(self.base)
                    self._same(changed, element).set(name, value)
                    yield (owner, element.tag), name, value, etree.tostring(changed)

    def _same(self, root, element):
        return root.getroottree().xpath(element.getroottree().getpath(element), namespaces=root.nsmap)[0]

    def _with(self, element, feature, new):
        changed = copy.deepcopy(self.base)
        owner = self._same(changed, element)
        if feature.get("upperBound") != "-1":
            for old in owner.findall(feature.get("name")):
                owner.remove(old)
        owner.append(copy.deepcopy(new))
        return etree.tostring(changed)
