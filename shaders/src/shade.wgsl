// Shading of the visible surface, once a pixel: the triangle is looked up by its identity and
// its vertices are interpolated at the pixel's centre.

@group(0) @binding(3) var<storage, read> colours: array<u32>;
// Kept numbers: four codes of 16 bits a vertex.
@group(0) @binding(4) var<storage, read> scalars: array<u32>;
@group(1) @binding(0) var identities: texture_2d<u32>;
// For each pixel, how much of the light is hidden from its point.
@group(1) @binding(1) var<storage, read> occlusion: array<u32>;
// Where RELIEF: of each pixel the direction of its surface as the eye sees it (right, up, towards the eye), and its
// depth in model lengths; all 0 where nothing is drawn. What `relief_fragment` writes.
@group(1) @binding(2) var relief: texture_2d<f32>;

// Whether shading looks at how the surface bends. Known when pipelines are made: it is 25 loads a pixel.
override RELIEF: bool = false;

@vertex
fn shade_vertex(@builtin(vertex_index) corner: u32) -> @builtin(position) vec4<f32> {
    // One triangle that covers the picture, at infinity: the depth test passes where something
    // was drawn.
    let p = vec2(f32(corner & 1u), f32(corner >> 1u));
    return vec4(p * 4.0 - 1.0, 0.0, 1.0);
}

fn linear_from_srgb(c: vec3<f32>) -> vec3<f32> {
    let high = pow((c + 0.055) / 1.055, vec3(2.4));
    return select(high, c / 12.92, c <= vec3(0.04045));
}

// Linear light.
fn colour_of(vertex: u32) -> vec3<f32> {
    return linear_from_srgb(unpack4x8unorm(colours[vertex]).rgb);
}

// The code of the number that is painted; 0 where there is no value.
fn code_of(vertex: u32) -> f32 {
    let k = u32(frame.scalar.x) - 1u;
    return f32((scalars[2u * vertex + (k >> 1u)] >> (16u * (k & 1u))) & 0xffffu);
}

// sRGB, of 0 to 1: see colour_map.rs in hlod-render.
fn viridis(t: f32) -> vec3<f32> {
    let c0 = vec3(0.27772733, 0.0054073445, 0.3340998);
    let c1 = vec3(0.10509304, 1.4046135, 1.3845902);
    let c2 = vec3(-0.33086183, 0.21484756, 0.09509516);
    let c3 = vec3(-4.6342305, -5.799101, -19.33244);
    let c4 = vec3(6.22827, 14.179933, 56.69055);
    let c5 = vec3(4.776385, -13.745145, -65.35303);
    let c6 = vec3(-5.4354558, 4.6458526, 26.312435);
    return c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * (c5 + t * c6)))));
}

// sRGB of what has no value.
const NO_VALUE: f32 = 122.0 / 255.0;

// Linear light, of a place among three vertices: what lies nearest to one without a value has none, and all
// else the mean of those with one.
fn number_colour(a: u32, b: u32, c: u32, w: vec3<f32>) -> vec3<f32> {
    let codes = vec3(code_of(a), code_of(b), code_of(c));
    let largest = max(w.x, max(w.y, w.z));
    let nearest = select(select(codes.z, codes.y, w.y == largest), codes.x, w.x == largest);
    if nearest == 0.0 {
        return linear_from_srgb(vec3(NO_VALUE));
    }
    let known = select(vec3(0.0), w, codes > vec3(0.0));
    let code = dot(known, codes) / (known.x + known.y + known.z);
    let t = clamp((code - frame.scalar.y) * frame.scalar.z, 0.0, 1.0);
    return linear_from_srgb(clamp(viridis(t), vec3(0.0), vec3(1.0)));
}

// Length of a pixel at the depth of a point in clip space, model space.
fn pixel_length(clip: vec4<f32>) -> f32 {
    return 2.0 * frame.points.y * select(1.0, clip.w, perspective()) / f32(frame.size.y);
}

// The direction of the surface, of three vertices' normals or of a point.
fn normal_at(seen: Seen, a: u32, b: u32, c: u32, of_point: bool) -> vec3<f32> {
    let w = seen.weights;
    let interpolated = w.x * octahedral(vertices[a].normal)
        + w.y * octahedral(vertices[b].normal)
        + w.z * octahedral(vertices[c].normal);
    return select(interpolated, seen.across, of_point);
}

// Whether a surface is seen from behind. A skirt stands for the surface that it hangs from, whichever of its own
// sides is seen.
fn is_turned(identity: u32, number: u32, outwards: f32) -> bool {
    return select((identity & BACK) != 0u, outwards < 0.0, is_of_skirt(number));
}

@fragment
fn relief_fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let identity = textureLoad(identities, vec2<i32>(pixel.xy), 0).x;
    let number = triangle_of(identity);
    if number == NONE {
        discard;
    }
    let seen = seen_point(number, in_picture(pixel.xy));
    let of_point = is_point(number);
    let a = indices[3u * number] & VERTEX;
    let b = indices[3u * number + 1u] & VERTEX;
    let c = select(indices[3u * number + 2u] & VERTEX, a, of_point);
    let given = normalize(normal_at(seen, a, b, c, of_point));
    let outwards = (frame.world_from_model * vec4(given, 0.0)).xyz;
    let to_eye = select(frame.eye.xyz, frame.eye.xyz - seen.world, frame.eye.w > 0.5);
    let back = is_turned(identity, number, dot(outwards, to_eye));
    let normal = select(given, -given, back & (frame.shading.w > 0.5));
    let axes = view_axes();
    let clip = frame.clip_from_model * vec4(seen.model, 1.0);
    let depth = select(-clip.z, clip.w, perspective()) * frame.points.z;
    let view = vec3(dot(normal, axes[0]), dot(normal, axes[1]), -dot(normal, axes[2]));
    return vec4(view, depth);
}

// Neighbours that are asked, on a spiral on which each has as much room as any other (Vogel 1979).
const NEIGHBOURS: u32 = 24u;
const GOLDEN_ANGLE: f32 = 2.3999631;
// What lies farther before or behind the plane of a surface than this many times its distance in the picture is
// another surface.
const STEPS_MAX: f32 = 4.0;
// By how much the surface turns within the radius where colours and contrast are strongest: 15°.
const TURN_MAX: f32 = 0.2617994;

// How the surface bends round a pixel: by how much it turns outwards within the radius, over TURN_MAX, −1 to 1;
// positive where it is convex. Half the divergence of its direction as the eye sees it (after Vergne et al., Radiance
// Scaling, I3D 2010, section 3), fitted to all neighbours within the radius on the same surface. Of a ball of
// radius R it is radius ÷ R, everywhere.
fn bend(pixel: vec2<f32>, pixel_side: f32) -> f32 {
    let centre = textureLoad(relief, vec2<i32>(pixel), 0);
    var turned = 0.0;
    var weight = 1e-6;
    for (var i = 0u; i < NEIGHBOURS; i++) {
        let angle = f32(i) * GOLDEN_ANGLE;
        let length = frame.relief.y * sqrt((f32(i) + 0.5) / f32(NEIGHBOURS));
        let offset = vec2<i32>(round(length * vec2(cos(angle), sin(angle))));
        let place = vec2<i32>(pixel) + offset;
        let other = textureLoad(relief, place, 0);
        let of_picture = place + vec2<i32>(frame.window.xy);
        let inside = all(of_picture >= vec2(0)) & all(of_picture < vec2<i32>(frame.size.xy))
            & all(place >= vec2(0)) & all(place < vec2<i32>(frame.window.zw));
        // Rows are counted downwards.
        let d = vec2<f32>(offset) * vec2(1.0, -1.0);
        let plane = centre.xyz + other.xyz;
        let expected = dot(plane.xy, d) * pixel_side / max(plane.z, 0.1);
        let is_near = abs(other.w - centre.w - expected) < STEPS_MAX * length * pixel_side;
        let counts = inside & is_near & (dot(other.xyz, other.xyz) > 0.5);
        turned += select(0.0, dot(other.xy - centre.xy, d), counts);
        weight += select(0.0, dot(d, d), counts);
    }
    return clamp(turned / weight * frame.relief.y / TURN_MAX, -1.0, 1.0);
}

// sRGB of a bend: blue where it is hollow, white where flat, orange where it bulges: see colour_map.rs in hlod-render.
fn bend_colour(bend: f32) -> vec3<f32> {
    let end = select(vec3(0.70, 0.35, 0.02), vec3(0.13, 0.40, 0.67), bend < 0.0);
    return mix(vec3(0.97), end, abs(bend));
}

// What share of the most that is shown full light is.
const FULL_LIGHT: f32 = 0.8;

// Light that is brighter where the surface bulges and darker where it is hollow: its odds are multiplied.
fn contrasted(light: f32, bend: f32) -> f32 {
    let gain = exp(3.0 * frame.relief.x * bend);
    // Full light leaves room for more, or nothing would change in it.
    let odds = clamp(light * FULL_LIGHT, 0.0, 1.0);
    return odds * gain / (1.0 - odds + odds * gain) / FULL_LIGHT;
}

@fragment
fn shade_fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let identity = textureLoad(identities, vec2<i32>(pixel.xy), 0).x;
    let number = triangle_of(identity);
    // Triangles of other arenas are shaded by their own draw.
    if number == NONE {
        discard;
    }
    // Always so, which no compiler knows: see `Frame`.
    let drawn = number < 0x7fffffffu;
    let back = (identity & BACK) != 0u;
    if back & (frame.shading.z > 0.5) {
        return vec4(1.0, 0.0, 1.0, 1.0);
    }

    let seen = seen_point(number, in_picture(pixel.xy));
    let w = seen.weights;
    let a = indices[3u * number] & VERTEX;
    let b = indices[3u * number + 1u] & VERTEX;
    // Of a point the last one is no vertex.
    let of_point = is_point(number);
    let c = select(indices[3u * number + 2u] & VERTEX, a, of_point);
    let normal = normal_at(seen, a, b, c, of_point);
    let position = seen.world;
    var n = normalize((frame.world_from_model * vec4(normal, 0.0)).xyz);
    var albedo = frame.material.rgb;
    if drawn & (frame.shading.y > 0.5) {
        albedo = w.x * colour_of(a) + w.y * colour_of(b) + w.z * colour_of(c);
    }

    // Open surfaces have two sides: the one that is seen faces the eye.
    let to_eye = normalize(select(frame.eye.xyz, frame.eye.xyz - position, frame.eye.w > 0.5));
    if CLIPPED & (drawn & (frame.bias.w > 0.5)) {
        // The inside of a body: what is seen is the face in which it was cut. Skirts stand inside, too. Points
        // have no backs but their normals.
        let outwards = (frame.world_from_model * vec4(octahedral(vertices[a].normal), 0.0)).xyz;
        let inside = back || is_of_skirt(number) || (of_point && dot(outwards, to_eye) < 0.0);
        let clip = frame.clip_from_model * vec4(seen.model, 1.0);
        let plane = entered_plane(clip_place(in_picture(pixel.xy), clip.z / clip.w));
        if inside && plane < 3u {
            return vec4(frame.clip_colours[plane].rgb, 1.0);
        }
    }
    let turned = is_turned(identity, number, dot(n, to_eye)) & (frame.shading.w > 0.5);
    if turned {
        n = -n;
    }
    if drawn & (frame.scalar.w > 0.5) {
        // Of the model's frame, and of the side that is seen.
        let towards = select(normal, -normal, turned);
        return vec4(linear_from_srgb(0.5 + 0.5 * normalize(towards)), 1.0);
    }
    if drawn & (frame.scalar.x > 0.5) {
        // No light of its own: colours are to be compared with the legend's. A little of the shape stays.
        let facing = 0.55 + 0.45 * abs(dot(n, to_eye));
        return vec4(number_colour(a, b, c, w) * facing, 1.0);
    }

    var bends = 0.0;
    if RELIEF {
        bends = bend(pixel.xy, pixel_length(frame.clip_from_model * vec4(seen.model, 1.0)));
        if drawn & (frame.relief.z > 0.5) {
            let facing = 0.55 + 0.45 * abs(dot(n, to_eye));
            return vec4(linear_from_srgb(bend_colour(bends)) * facing, 1.0);
        }
    }

    // Lambert, a little specular (Blinn 1977), and ambient light that comes from above the eye's
    // side so that shadowed parts keep their shape.
    let to_light = normalize(select(frame.light.xyz, frame.light.xyz - position, frame.light.w > 0.5));
    var visibility = 1.0;
    if drawn & (frame.shadow.x > 0.5) {
        visibility -= f32(occlusion[number_of(vec2<u32>(pixel.xy))]) / f32(HIDDEN);
    }
    let side = frame.spot.w;
    visibility *= smoothstep(side, mix(1.0, side, 0.81), dot(frame.spot.xyz, to_light));
    let diffuse = visibility * max(dot(n, to_light), 0.0);
    let half_way = normalize(to_light + to_eye);
    let highlight = frame.material.a * pow(max(dot(n, half_way), 0.0), 24.0) * diffuse;
    let ambient = frame.shading.x * (0.6 + 0.4 * dot(n, to_eye));
    var light = ambient + (1.0 - frame.shading.x) * diffuse;
    if RELIEF {
        light = contrasted(light, bends);
    }
    return vec4(albedo * light + highlight, 1.0);
}
