//! Checks of the invariants of a finished tree.

use super::parts::KIND_TRIANGLE;
use super::wide::{Child, Tree, WIDTH};
use super::{Bvh, Quality};
use crate::math::Bounds3;

impl Bvh {
    /// Checks that every primitive is in exactly one leaf and inside every box above it; where boxes are cut, that it meets
    /// the boxes of its leaves. Costs as much as a build.
    pub fn validate(&self) -> Result<(), String> {
        let cut = self.options.quality == Quality::High;
        validate_tree(&self.top, cut)?;
        self.groups.iter().try_for_each(|tree| validate_tree(tree, cut))
    }
}

fn validate_tree(tree: &Tree, cut: bool) -> Result<(), String> {
    if tree.root == Child::NONE {
        return Ok(());
    }
    let mut seen_ids = vec![false; tree.parts.len()];
    let mut seen_nodes = vec![false; tree.nodes.len()];
    let mut stack = vec![(tree.root, tree.bounds)];
    while let Some((child, bounds)) = stack.pop() {
        if child.is_node() {
            let index = child.0 as usize;
            let node = tree.nodes.get(index).ok_or_else(|| format!("node {index} does not exist"))?;
            if std::mem::replace(&mut seen_nodes[index], true) {
                return Err(format!("node {index} has two parents"));
            }
            for slot in 0..WIDTH {
                if node.child[slot] != Child::NONE {
                    let b = node.slot_bounds(slot);
                    inside(&b, &bounds, || format!("slot {slot} of node {index}"))?;
                    stack.push((node.child[slot], b));
                }
            }
            continue;
        }
        let mut see = |id: u32| {
            let twice = seen_ids.get_mut(id as usize).is_none_or(|seen| std::mem::replace(seen, true) && !cut);
            if twice { Err(format!("primitive {id} is out of range or stored twice")) } else { Ok(()) }
        };
        if child.kind() != KIND_TRIANGLE {
            see(child.id())?;
            continue;
        }
        for block in tree.blocks.get(child.blocks()).ok_or("a leaf refers to blocks that do not exist")? {
            for (lane, &id) in block.id.iter().enumerate().filter(|(_, id)| **id != u32::MAX) {
                see(id)?;
                if block.triangle(lane) != tree.parts.triangle(id) {
                    return Err(format!("triangle {id} differs from its mesh"));
                }
                let own = Bounds3::from_points(block.triangle(lane));
                if cut && !(own.min.cmple(bounds.max).all() && bounds.min.cmple(own.max).all()) {
                    return Err(format!("triangle {id} is not in its box"));
                }
                if !cut {
                    inside(&own, &bounds, || format!("triangle {id}"))?;
                }
            }
        }
    }
    if seen_nodes.contains(&false) {
        return Err("a node has no parent".to_owned());
    }
    Ok(())
}

fn inside(b: &Bounds3, outer: &Bounds3, name: impl Fn() -> String) -> Result<(), String> {
    if outer.contains(b.min) && outer.contains(b.max) { Ok(()) } else { Err(format!("{} leaves its box", name())) }
}
