//! Views of multi-view pictures, such as the eyes of stereo.
//!
//! A file of one part lists its views in the attribute `multiView`, the default one first; layers of the other views
//! have their view's name among the words of theirs: `right`, `diffuse.right`. In a file of several parts the attribute
//! `view` of a part names its view.

use super::header::{Header, LayerInfo};
use super::picture;

impl Header {
    /// Returns the names of the views, the default one first; none for a picture of one view.
    pub(crate) fn views(&self) -> Vec<String> {
        let mut views: Vec<String> = Vec::new();
        let listed = self.parts.iter().filter_map(|part| part.attributes.get("multiView"));
        let own = self.parts.iter().filter_map(|part| part.attributes.get("view"));
        for name in listed.flat_map(|list| list.split(", ")).chain(own.map(String::as_str)) {
            if !name.is_empty() && !views.iter().any(|known| known == name) {
                views.push(name.to_owned());
            }
        }
        if views.len() > 1 { views } else { Vec::new() }
    }

    /// Returns the number of a layer's view among [`views`](Self::views); 0 for layers of no other view.
    pub(crate) fn view_of(&self, layer: &LayerInfo) -> usize {
        let views = self.views();
        let number = |name: &str| views.iter().position(|view| view == name);
        let own = self.parts[layer.part].attributes.get("view").and_then(|view| number(view));
        own.or_else(|| layer.name.split('.').find_map(number)).unwrap_or(0)
    }

    /// Returns the name of a layer without the word for its view.
    pub(crate) fn name_in_view(&self, layer: &LayerInfo) -> String {
        let views = self.views();
        let view = views.get(self.view_of(layer)).map_or("", String::as_str);
        layer.name.split('.').filter(|word| view.is_empty() || *word != view).collect::<Vec<_>>().join(".")
    }

    /// Returns the layer of a view that corresponds to a layer of another one: that of the same name but for the
    /// view's, or, for the only colors of its view, the only colors of the other.
    pub(crate) fn counterpart(&self, layer: &LayerInfo, view: usize) -> Option<LayerInfo> {
        if self.view_of(layer) == view {
            return Some(layer.clone());
        }
        let name = self.name_in_view(layer);
        let all = self.layers();
        let of_view = || all.iter().filter(|other| self.view_of(other) == view);
        let is_colored = |layer: &LayerInfo| picture::colors(self, layer).is_some_and(|channels| channels.len() > 2);
        let only_colors = |view: usize| {
            let mut colored = all.iter().filter(|other| self.view_of(other) == view && is_colored(other));
            colored.next().filter(|_| colored.next().is_none())
        };
        let only = only_colors(view).filter(|_| only_colors(self.view_of(layer)).is_some() && is_colored(layer));
        of_view().find(|other| self.name_in_view(other) == name).or(only).cloned()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is how a test fails")]
mod tests {
    use super::super::Window;
    use super::super::header::{ChannelInfo, Part, SampleType};
    use super::*;
    use std::collections::BTreeMap;

    /// The names of a part's layers of color, and its attributes.
    type Layers<'p> = (&'p [&'p str], &'p [(&'p str, &'p str)]);

    /// Header of parts.
    fn header(parts: &[Layers<'_>]) -> Header {
        let window = Window { min: [0; 2], size: [4, 4] };
        let channel = |layer: &str, component: &str| ChannelInfo {
            name: format!("{layer}.{component}"),
            layer: layer.into(),
            component: component.into(),
            sample_type: SampleType::Half,
            sampling: [1; 2],
        };
        let part = |(layers, attributes): &Layers<'_>| Part {
            name: None,
            data_window: window,
            compression: String::new(),
            tiled: false,
            channels: layers.iter().flat_map(|layer| ["R", "G", "B"].map(|c| channel(layer, c))).collect(),
            attributes: attributes.iter().map(|(k, v)| ((*k).into(), (*v).into())).collect::<BTreeMap<_, _>>(),
        };
        let parts = parts.iter().map(part).collect();
        Header { display_window: window, data_window: window, pixel_aspect: 1.0, parts }
    }

    fn counterpart(header: &Header, name: &str, view: usize) -> Option<String> {
        let layer = header.layers().into_iter().find(|layer| layer.name == name).unwrap();
        header.counterpart(&layer, view).map(|layer| layer.name)
    }

    #[test]
    fn layers_of_one_part_bear_the_names_of_their_views() {
        let names = ["", "Vector", "right", "Vector.right", "mask"];
        let header = header(&[(&names, &[("multiView", "left, right")])]);
        assert_eq!(header.views(), ["left", "right"]);
        assert_eq!(counterpart(&header, "", 1).unwrap(), "right");
        assert_eq!(counterpart(&header, "Vector.right", 0).unwrap(), "Vector");
        assert_eq!(counterpart(&header, "mask", 1), None);
        assert_eq!(counterpart(&header, "mask", 0).unwrap(), "mask");
    }

    #[test]
    fn parts_state_their_views() {
        let [left, right] = ["left", "right"].map(|view| [("view", view)]);
        let named = header(&[(&["rgba.left"], &left), (&["depth.left"], &left), (&["rgba.right", "x"], &right)]);
        assert_eq!(counterpart(&named, "rgba.left", 1).unwrap(), "rgba.right");
        assert_eq!(counterpart(&named, "depth.left", 1), None);
        // Names that say nothing of the view.
        let eyes = header(&[(&["a"], &left), (&["b"], &right)]);
        assert_eq!(counterpart(&eyes, "a", 1).unwrap(), "b");
        let plain = header(&[(&["", "right"], &[])]);
        assert!(plain.views().is_empty() && counterpart(&plain, "right", 0).unwrap() == "right");
    }
}
